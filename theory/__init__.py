"""The mathematics: switching languages, stability, gains, reachable sets, and certificates that anyone can check."""
