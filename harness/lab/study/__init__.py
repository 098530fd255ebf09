"""The paper's two studies, repeated on held-out traffic with every motion model."""
