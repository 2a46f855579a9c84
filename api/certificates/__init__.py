"""Certificates: questions about switched systems, answered with proofs that anyone can check."""
