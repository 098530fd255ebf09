"""The requirements on every tracker, and scripted scenes that check them."""
