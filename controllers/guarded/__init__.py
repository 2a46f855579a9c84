"""The guarded controller: `switched` as long as the reserve rule could still keep its promise, else that rule."""
