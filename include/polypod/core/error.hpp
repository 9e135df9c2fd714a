// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Bad input is a value: an Error with a stable id, its place and a hint. Nothing here throws or prints.
#pragma once

#include <string>
#include <tl/expected.hpp>

namespace polypod {

/// Where in a file an error was found. Lines and columns count from 1; 0 means "the file as a whole".
struct Place {
  std::string file;
  int line = 0;
  int column = 0;
};

/// What was wrong with the input.
///
/// `id` is stable across versions (two letters of the module and a number, listed in docs/errors.md), `message` names
/// the value and the rule that it breaks, `hint` says what to do.
struct Error {
  std::string id;
  std::string message;
  Place place;
  std::string hint;
};

template <class T>
using Result = tl::expected<T, Error>;

using Status = tl::expected<void, Error>;

/// Makes the unexpected value that a function with a Result returns.
[[nodiscard]] inline tl::unexpected<Error> fail(std::string id, std::string message, Place place = {},
                                                std::string hint = {}) {
  return tl::unexpected<Error>(Error{std::move(id), std::move(message), std::move(place), std::move(hint)});
}

/// One line for a person: `GC104 part.ngc:12:9: G2 without I, J or R; an arc needs its centre or radius`.
std::string to_string(const Error& error);

}  // namespace polypod

/// Leaves the function with the error of `expression` (a Status or a Result), if it has one.
#define POLYPOD_TRY(expression)                                                                       \
  do {                                                                                                \
    if (auto polypod_try_ = (expression); !polypod_try_) return tl::unexpected(polypod_try_.error()); \
  } while (false)

/// Declares `name` with the value of `expression` (a Result), or leaves the function with its error.
#define POLYPOD_ASSIGN(name, expression)                              \
  auto name##_result_ = (expression);                                 \
  if (!name##_result_) return tl::unexpected(name##_result_.error()); \
  auto name = std::move(*name##_result_)
