"""HTTP and websocket, under /api/v1: one router a resource."""
