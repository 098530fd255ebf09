"""Where vehicles may be: the road, lanes as a graph, and the plane around the sensor."""
