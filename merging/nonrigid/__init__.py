"""Non-rigid registration of two maps that no rigid transform aligns."""
