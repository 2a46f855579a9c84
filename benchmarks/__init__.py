"""What the twin costs and how close it comes: measurements with their spread, and the documents made from them."""
