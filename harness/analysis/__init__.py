"""Turns rows of results into curves, tables, costs of mismatches, and verdicts on B against A."""
