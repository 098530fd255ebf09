"""How long trackers take: a step by stage against the number of vehicles, and the mixtures' sampling."""
