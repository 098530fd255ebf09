"""Colours and ellipse sizes that all pictures and exports share."""

# Okabe and Ito's colours, which colour-blind readers can tell apart.
GREEN, ORANGE, VERMILION, BLUE, PURPLE = "#009E73", "#E69F00", "#D55E00", "#0072B2", "#882255"
# A two-dimensional normal distribution holds 95 % within this many standard deviations.
ELLIPSE_SCALE = 2.4477
STATE_COLOURS = {"visible": GREEN, "partial": ORANGE, "hidden": VERMILION, "out": "#b0b0b0"}
EGO_COLOUR, DETECTION_COLOUR, LANE_COLOUR = "#000000", "#0072B2", "#8c8c8c"
