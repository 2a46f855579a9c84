"""Live twins: a station that runs on the wall clock, its controller, what it tells and what it keeps."""
