"""Sources of true vehicle motion."""
