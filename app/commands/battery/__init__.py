"""The work of `voltwall battery`: profiles of batteries that are not the team's own."""
