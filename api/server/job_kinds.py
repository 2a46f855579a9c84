"""The kinds of jobs there are: what the queue and the executors are given."""

from __future__ import annotations

from api.calibrations.job import CALIBRATION
from api.certificates.job import CERTIFICATE
from api.comparisons.job import COMPARISON
from api.forecasts.job import FORECAST
from api.jobs.work import JobTypes
from api.runs.job import RUN
from api.shadows.job import SHADOW
from api.store.records import JobKind

JOB_TYPES: JobTypes = {
    JobKind.RUN: RUN,
    JobKind.COMPARISON: COMPARISON,
    JobKind.CERTIFICATE: CERTIFICATE,
    JobKind.CALIBRATION: CALIBRATION,
    JobKind.FORECAST: FORECAST,
    JobKind.SHADOW: SHADOW,
}
