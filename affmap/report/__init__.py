"""Tables on disk -> statistics, figures and a document. Knows files only: no models, no environment, no torch."""
