"""Programs: they parse, call, report and end with an exit code; no algorithm lives here."""
