"""Plants: what a station physically is, apart from who controls it."""
