"""A kit for routes that knows no resource: problems, pages, ETags, idempotency, authentication, limits, series."""
