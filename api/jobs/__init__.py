"""Jobs: work that outlives a request; the only room that starts processes."""
