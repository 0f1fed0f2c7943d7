"""The report: one page that plays."""
