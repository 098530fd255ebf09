"""What every tracker has to keep to, and scripted scenes that check it."""
