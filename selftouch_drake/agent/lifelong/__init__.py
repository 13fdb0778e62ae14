"""Learning that never stops: the agent explores, learns, notices changes of its body, and adapts.

The agent knows what it expects to feel (`expectation`), and how much its touches surprise it
(`alarm`). After an alarm it explains the change, from simple to complicated (`explanation`), and
goes on with what still holds (`life`). Where it goes is decided in `explorer`, what it learns in
`learner`. Nothing in this knows what a joint is, or its unit. See `docs/changing_body.md`.
"""
