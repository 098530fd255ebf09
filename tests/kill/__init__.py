"""Commands killed at random moments: what was finished stays, and what is taken up again ends as if nothing was."""
