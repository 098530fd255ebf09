"""Whether behaviour models carry over: trained on simulated and real traffic, tested on both."""
