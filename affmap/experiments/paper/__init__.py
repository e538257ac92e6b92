"""The report of all experiments of the paper."""
