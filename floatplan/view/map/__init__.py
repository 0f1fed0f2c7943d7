"""A study as a page: maps, and the plan of any point of them."""
