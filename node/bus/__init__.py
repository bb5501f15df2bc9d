"""The bus that carries levels, scans and events to whoever listens."""
