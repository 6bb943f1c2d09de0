"""The result for people and for programs: view, HTML, text, JSON."""
