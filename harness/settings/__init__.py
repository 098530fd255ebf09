"""Which settings and named things there are, for people and programs to look up."""
