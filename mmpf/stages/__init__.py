"""The stages of a step that both update rules share: prediction, the role of an update rule, and reporting."""
