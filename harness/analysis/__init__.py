"""From rows of results to statements: curves, tables, costs of mismatches, and whether B is better than A."""
