"""The joint update: soft association of all components and detections."""
