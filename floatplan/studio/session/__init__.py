"""The session: what is asked, what is answered, and what was done: without a page."""
