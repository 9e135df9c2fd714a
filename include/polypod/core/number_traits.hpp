// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What Eigen asks of the number types of proofs.
#pragma once

#include <Eigen/Core>

namespace polypod {

/// Base of Eigen::NumTraits<T> for a number type of our own; the costs are in operations on double.
template <class T, int read, int add, int multiply>
struct NumberTraits : Eigen::GenericNumTraits<double> {
  using Real = T;
  using NonInteger = T;
  using Nested = T;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = read,
    AddCost = add,
    MulCost = multiply
  };
};

}  // namespace polypod
