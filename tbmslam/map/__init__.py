"""The map of one robot: drives, keyframes and the rendered grid."""
