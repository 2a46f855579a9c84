"""The page at `/`: a live twin and the jobs, from files that ship with the package."""
