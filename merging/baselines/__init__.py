"""The related work's ways of finding where one map lies in another, one method a file, named after its authors.

They serve comparison under equal conditions: the same pairs, processor and interface, `align(target, source, config)`.
None published its code; each file says what is its authors' idea and what was chosen here.
"""
