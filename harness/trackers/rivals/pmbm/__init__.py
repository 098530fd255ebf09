"""The Poisson multi-Bernoulli mixture filter: assignments, clusters of hypotheses, the filter and the tracker."""
