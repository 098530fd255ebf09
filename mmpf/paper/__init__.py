"""The paper's own update: the largest likelihood."""
