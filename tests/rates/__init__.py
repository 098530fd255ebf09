"""The same traffic seen at other scan rates: how far the filter stays behind the oracle at each."""
