"""Where vehicles can be: the road, lanes as a graph, and the plane around the sensor."""
