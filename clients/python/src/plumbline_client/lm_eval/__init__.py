"""Tasks of one turn for lm-eval's harness: `lm_eval run --tasks mineceraft_lite_one_turn --include_path FOLDER`.

`plumbline-client lm-eval` prints the folder. The service is that of `PLUMBLINE_SERVER`.
"""
