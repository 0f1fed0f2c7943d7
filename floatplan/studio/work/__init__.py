"""The planning behind the page, in processes of its own: the page stays quick, and what is out of date ends at once."""
