"""Skins of links: closed surfaces, the wall below them, and receptors spread over them."""
