"""How real the simulated traffic is, and the fit of its drivers and demands to what was measured."""
