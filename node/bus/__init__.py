"""The bus that carries levels, scans, states and events to whoever listens."""
