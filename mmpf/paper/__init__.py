"""The paper's update: the largest likelihood."""
