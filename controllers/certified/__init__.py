"""Certificates of a station under control: how well its tanks are known, and that vehicles are served."""

from controllers.certified.estimation import Estimate, Estimator
from controllers.certified.prediction import predict
from controllers.certified.tanks import Box, Group, group_of

__all__ = ["Box", "Estimate", "Estimator", "Group", "group_of", "predict"]
