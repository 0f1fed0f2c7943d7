"""While it flies: corrections of a plan's motion, from what is measured on the way."""
