"""The work of `voltwall season`: what many sessions say together."""
