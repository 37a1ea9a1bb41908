"""The HTTP service of `gash serve`. docs/service.md says how it is spoken to."""
