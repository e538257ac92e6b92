"""A window in which one flies the vehicle, or watches an agent imagine and fly: `affmap-play`."""
