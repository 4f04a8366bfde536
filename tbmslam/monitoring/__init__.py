"""What watches over a drive: it notices what goes wrong, says when, and keeps the worst out of the map."""
