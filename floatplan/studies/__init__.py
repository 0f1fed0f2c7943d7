"""Studies: many plans of one problem, each with other numbers, in a table and in maps."""
