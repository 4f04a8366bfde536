"""The parameters: presets, overrides and their TOML."""
