"""Bridges to what users already have: a folder for each protocol, each an extra that nothing else imports."""
