"""What is certified of a station under control: how well its tanks are known."""

from controllers.certified.estimation import Box, Estimate, Estimator, group_of
from controllers.certified.prediction import predict

__all__ = ["Box", "Estimate", "Estimator", "group_of", "predict"]
