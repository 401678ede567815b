"""Maps from image distances alone: around a query, of a room, of a whole grid."""
