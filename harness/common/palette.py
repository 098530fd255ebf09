"""Colours and ellipse sizes that all pictures and exports share."""

# Okabe and Ito's colours, which colour-blind readers can tell apart.
GREEN, ORANGE, VERMILION, BLUE, PURPLE = "#009E73", "#E69F00", "#D55E00", "#0072B2", "#882255"
# A two-dimensional normal distribution holds 95 % within this many standard deviations.
ELLIPSE_SCALE = 2.4477
