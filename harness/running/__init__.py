"""One run: looks in, tracks out, from configuration to finished folder."""
