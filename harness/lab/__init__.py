"""Studies, fits and measurements of the maintainers; nothing of the product imports them."""
