"""The stages that both update rules share: prediction, the update-rule protocol and reporting."""
