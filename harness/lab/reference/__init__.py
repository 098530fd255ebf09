"""Reference tables: which there are, and how each is made by one command."""
