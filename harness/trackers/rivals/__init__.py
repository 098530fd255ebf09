"""Current trackers, implemented here from their papers: box trackers and the PMBM filter."""
