"""report.json, the page and its pictures."""
