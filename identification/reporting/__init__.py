"""Reporting: plots, pages, tables and texts that show results."""
