"""The search of `switched` over constants identified on line, each with the set of values its readings admit."""
