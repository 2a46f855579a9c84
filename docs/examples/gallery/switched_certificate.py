"""How fast may two stable systems be switched? The smallest dwell time, proved, and checked without a solver.

    python docs/examples/gallery/switched_certificate.py

It prints

    arbitrary switching: stability does not hold: repeating 1 2 is admissible and decays no faster than 1^k
    dwell time 5: for every admissible signal: |x(k)| <= c r^k |x(0)| for some c and some r < 1
    the same for dwell time 1: uncovered word: 1 2 1 is admissible, and no path of the graph
"""

import json

from theory import ArbitrarySwitching, DwellTime, NotCertifiedError, Refused, SwitchedSystem, stability, verify
from theory.checker import checksum

MODES = [[[0.5, 2.0], [0.0, 0.5]], [[0.5, 0.0], [2.0, 0.5]]]
"""Both have the eigenvalues 0.5 and 0.5."""


def main():
    """Search the dwell time, then claim more than the certificate proves."""
    system = SwitchedSystem(A=MODES)
    try:
        stability.certify(system, ArbitrarySwitching(modes=2))
    except NotCertifiedError as error:
        print(f"arbitrary switching: {error}")
    for tau in range(1, 21):
        try:
            certificate = stability.certify(system, DwellTime(tau, modes=2))
        except NotCertifiedError:
            continue
        print(f"dwell time {tau}: {verify(certificate.document).claim}")
        break
    forged = json.loads(json.dumps(certificate.document))
    forged["problem"]["constraint"]["tau"] = 1
    forged["checksum"] = checksum(forged)
    try:
        verify(forged)
    except Refused as error:
        print(f"the same for dwell time 1: {error}")


if __name__ == "__main__":
    main()
