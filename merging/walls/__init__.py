"""What a map shows of walls."""
