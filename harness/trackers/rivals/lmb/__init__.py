"""The labelled multi-Bernoulli filter of multisensor-lmb-filters-rs."""
