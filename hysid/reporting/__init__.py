"""The report: self-contained HTML pages."""
