"""Made-up buildings, robots that drive through them, and what they measure: recordings whose truth is known."""
