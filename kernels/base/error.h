// SPDX-License-Identifier: Apache-2.0
// The typed errors of all code. They carry the program's exit code; only apps/ prints and exits.
#pragma once

#include <stdexcept>
#include <string>

namespace gs {

enum class ExitCode : int {
    kOk = 0,
    kUnexpected = 1,
    kUsage = 2,         ///< command line or configuration
    kDataset = 3,       ///< input files, and files that cannot be written
    kDevice = 4,        ///< device or memory
    kNumeric = 5,       ///< a training whose parameters or losses do not stay finite
    kInterrupted = 130  ///< stopped by the user after writing a checkpoint
};

/// The base of all gsapp errors. The message names file, field and value, and the likely cause if it is known. It is
/// empty if another process reports the error.
class Error : public std::runtime_error {
  public:
    Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
    ExitCode code() const { return code_; }

  private:
    ExitCode code_;
};

struct UsageError : Error {
    explicit UsageError(const std::string& m) : Error(ExitCode::kUsage, m) {}
};
struct DataError : Error {
    explicit DataError(const std::string& m) : Error(ExitCode::kDataset, m) {}
};
struct DeviceError : Error {
    explicit DeviceError(const std::string& m) : Error(ExitCode::kDevice, m) {}
};
struct NumericError : Error {
    explicit NumericError(const std::string& m) : Error(ExitCode::kNumeric, m) {}
};
struct Interrupted : Error {
    explicit Interrupted(const std::string& m) : Error(ExitCode::kInterrupted, m) {}
};

}  // namespace gs
