"""`voltwall identify` and `voltwall estimate`: a model fitted to measurements, a filter run over them."""
