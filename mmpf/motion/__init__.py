"""Motion models: how a vehicle may move in one time step, given road and traffic around it."""
