// SPDX-License-Identifier: Apache-2.0
// Writes stats/train.jsonl.
#include "lib/train/train_log.h"

#include "kernels/core/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/io/atomic_file.h"

namespace gs {

TrainLog::TrainLog(const std::filesystem::path& path, std::int64_t iteration) : path_(path) {
    std::string kept;
    if (iteration > 0 && path_exists(path)) {
        std::ifstream in = open_input(path);
        for (std::string line; std::getline(in, line);) {
            const auto json = try_parse_json(line);  // a crash may have cut the last line short
            const auto at = json.is_object() ? json.find("iteration") : json.end();
            if (at != json.end() && at->is_number_integer() && *at <= iteration) kept += line + "\n";
        }
    }
    std::error_code ignored;  // the write below reports errors
    std::filesystem::create_directories(path.parent_path(), ignored);
    write_text_atomic(path, kept);
    out_.open(path, std::ios::app);
}

void TrainLog::write(const nlohmann::json& line) {
    out_ << json_text(line) << std::endl;  // flushed, because others read the file during the run
    if (!out_) throw DataError(path_.string() + ": cannot write the training log (disk full?)");
}

}  // namespace gs
