"""Tasks for Inspect (`inspect_ai`): `inspect eval plumbline_client/mineceraft_lite --model PROVIDER/MODEL`.

Needs the extra `plumbline-client[inspect]`. The service is that of `PLUMBLINE_SERVER`, with the key in `PLUMBLINE_KEY`.
"""
