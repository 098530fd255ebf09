"""Studies, fits and measurements for maintainers; no product code imports them."""
