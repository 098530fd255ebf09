"""Every option of the filter."""
