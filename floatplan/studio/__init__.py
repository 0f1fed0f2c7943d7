"""The studio: a local page on which a flight is made by hand."""
