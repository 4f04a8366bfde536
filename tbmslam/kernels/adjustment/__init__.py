"""The equations of the adjustment and their solver."""
