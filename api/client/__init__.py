"""The client of a running service: `Service` for runs, comparisons and twins, `Twin` for one that lives.

The command line uses it, too.
"""

from api.client.jobs import Comparison, Forecast, Job, JobError, Run
from api.client.series import Series
from api.client.service import Service
from api.client.transport import (
    AGAIN_S,
    PATIENCE_S,
    BrokenConnectionError,
    Client,
    ServiceError,
    refused,
)
from api.client.twin import Message, Sample, Twin

__all__ = [
    "AGAIN_S",
    "PATIENCE_S",
    "BrokenConnectionError",
    "Client",
    "Comparison",
    "Forecast",
    "Job",
    "JobError",
    "Message",
    "Run",
    "Sample",
    "Series",
    "Service",
    "ServiceError",
    "Twin",
    "refused",
]
