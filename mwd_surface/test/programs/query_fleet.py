# SPDX-License-Identifier: Apache-2.0
"""Query the tables of a fleet as another program does. Argument: the folder of the fleet."""

import sys

import duckdb

SURVEYS = "select count(*), count(distinct bag), min(inclination_deg) from '{0}/surveys/*.parquet'"
BINS = "select sum(samples) from '{0}/attitude/*.parquet'"
print(*(duckdb.connect().execute(one.format(sys.argv[1])).fetchone() for one in (SURVEYS, BINS)), sep="\n")
