# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The paper, whole: every table and figure by one command.

An experiment is a list of runs (:mod:`~experiments.paper.jobs`), which a runner performs in
parallel (:mod:`~experiments.paper.runner`) and whose results it appends to a store
(:mod:`~experiments.paper.store`). Tables and pictures are made of the store alone.
"""
