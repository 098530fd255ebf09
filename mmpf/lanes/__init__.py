"""Roads of any shape: lanes as a graph of lines in the plane."""
