"""Evidence for and against a pose hypothesis, and its covariance."""
