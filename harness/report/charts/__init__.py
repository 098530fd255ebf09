"""Charts that answer when pointed at: specifications in Vega-Lite's grammar, drawn in the page by Vega itself."""
