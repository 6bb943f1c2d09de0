"""Answers for language models: the verbs as tools of an MCP server, which read and write nothing else."""
