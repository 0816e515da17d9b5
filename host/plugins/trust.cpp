#include "plugins/trust.hpp"

#include "common/error.hpp"
#include "plugins/library.hpp"

#include <fcntl.h>
#include <nettle/sha2.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <system_error>

namespace cleave::plugins {
namespace {

namespace fs = std::filesystem;

constexpr const char* isolation = "CLEAVE_ISOLATE";

bool lies_in(const fs::path& file, const fs::path& directory) {
  return std::mismatch(directory.begin(), directory.end(), file.begin(), file.end()).first == directory.end();
}

/// Tells the parent a refusal, or with a first '+' that there is none.
void answer(int pipe, const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t n = ::write(pipe, text.data() + done, text.size() - done);
    if (n <= 0) return;
    done += std::size_t(n);
  }
}

[[noreturn]] void open_in_child(const fs::path& library, int pipe) {
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  const rlimit no_core{0, 0};
  ::setrlimit(RLIMIT_CORE, &no_core);
  for (const int signal : {SIGINT, SIGTERM, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) ::signal(signal, SIG_DFL);
  const int nothing = ::open("/dev/null", O_RDWR);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) ::dup2(nothing, stream);
  try {
    open_library(library);
    answer(pipe, "+");
  } catch (const std::exception& problem) {
    answer(pipe, "-" + std::string(problem.what()));
  }
  ::_exit(0);
}

/// How a child ended that gave no answer.
std::string end_of(int status) {
  if (WIFSIGNALED(status))
    return "crashes when it is opened: signal " + std::to_string(WTERMSIG(status)) + " (" + ::strsignal(WTERMSIG(status)) + ")";
  return "ends the process when it is opened, with exit status " + std::to_string(WEXITSTATUS(status));
}

}  // namespace

void allow_plugins_from(const fs::path& directory) {
  std::error_code error;
  if (!fs::is_directory(directory, error))
    throw InputError("--allow-plugins-from " + directory.string() + ": there is no such directory");
  std::string path = fs::absolute(directory).lexically_normal().string();
  if (path.find(':') != std::string::npos)
    throw InputError("--allow-plugins-from " + directory.string() + ": a directory of plugins must have no ':' in its path");
  if (const char* others = std::getenv("CLEAVE_PLUGIN_PATH"); others && *others) path += ":" + std::string(others);
  ::setenv("CLEAVE_PLUGIN_PATH", path.c_str(), 1);
}

void isolate_plugins() { ::setenv(isolation, "1", 1); }

bool plugins_are_isolated() {
  const char* value = std::getenv(isolation);
  return value && *value && std::string_view(value) != "0";
}

std::optional<std::string> problem_with_place(const fs::path& file, const std::vector<fs::path>& directories) {
  std::error_code error;
  const fs::path real = fs::canonical(file, error);
  if (error) return "cannot be read";
  if (!fs::is_regular_file(real, error)) return "is no regular file";
  for (const auto& directory : directories) {
    const fs::path place = fs::canonical(directory, error);
    if (!error && lies_in(real, place)) return std::nullopt;
  }
  return "is a link to " + real.string() + ", outside of the directories of plugins; allow it with --allow-plugins-from " +
         real.parent_path().string();
}

std::vector<fs::path> world_writable(const fs::path& file) {
  std::vector<fs::path> all;
  std::error_code error;
  const fs::path real = fs::canonical(file, error);
  if (error) return all;
  const auto mode_of = [](const fs::path& path) {
    struct stat status {};
    return ::stat(path.c_str(), &status) == 0 ? status.st_mode : mode_t(0);
  };
  if (mode_of(real) & S_IWOTH) all.push_back(real);
  // Into a directory of plugins anybody may put a further one, even where only owners may remove files.
  if (mode_of(real.parent_path()) & S_IWOTH) all.push_back(real.parent_path());
  for (fs::path above = real.parent_path(); above.has_relative_path();) {
    above = above.parent_path();
    if ((mode_of(above) & (S_IWOTH | S_ISVTX)) == S_IWOTH) all.push_back(above);
  }
  return all;
}

std::string sha256_of_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  sha256_ctx context;
  sha256_init(&context);
  std::vector<char> buffer(1 << 16);
  while (file.read(buffer.data(), std::streamsize(buffer.size())), file.gcount() > 0)
    sha256_update(&context, std::size_t(file.gcount()), reinterpret_cast<const std::uint8_t*>(buffer.data()));
  if (!file.eof()) throw InputError("cannot read " + path.string());
  std::array<std::uint8_t, SHA256_DIGEST_SIZE> digest;
  sha256_digest(&context, digest.size(), digest.data());
  std::string text;
  for (const unsigned byte : digest) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02x", byte);
    text += digits;
  }
  return text;
}

std::optional<std::string> problem_in_child(const fs::path& library, double seconds) {
  using Clock = std::chrono::steady_clock;
  const auto deadline = Clock::now() + std::chrono::duration<double>(seconds);
  int pipe[2];
  if (::pipe2(pipe, O_CLOEXEC) != 0) throw InputError("cannot open " + library.string() + " in a child process: no pipe");
  std::fflush(nullptr);
  const pid_t child = ::fork();
  if (child == 0) open_in_child(library, pipe[1]);
  const int reason = errno;
  ::close(pipe[1]);
  if (child < 0) {
    ::close(pipe[0]);
    throw InputError("cannot open " + library.string() + " in a child process: " + std::generic_category().message(reason));
  }
  ::setpgid(child, child);  // whichever of the two is first
  ::fcntl(pipe[0], F_SETFL, O_NONBLOCK);

  std::string answer;
  const auto take = [&] {
    std::array<char, 4096> buffer;
    for (ssize_t n; (n = ::read(pipe[0], buffer.data(), buffer.size())) > 0;) answer.append(buffer.data(), std::size_t(n));
  };
  int status = 0;
  bool ended = false;
  while (!ended && Clock::now() < deadline) {
    pollfd wait{pipe[0], POLLIN, 0};
    ::poll(&wait, 1, 5);
    take();
    ended = ::waitpid(child, &status, WNOHANG) == child;
    if (!ended && (wait.revents & POLLHUP)) ::usleep(1000);
  }
  // With all that it has started.
  ::kill(-child, SIGKILL);
  if (!ended)
    while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
  take();
  ::close(pipe[0]);
  if (!answer.empty() && answer[0] == '+' && ended) return std::nullopt;
  if (!answer.empty() && answer[0] == '-') return answer.substr(1);
  if (!ended) {
    char limit[32];
    std::snprintf(limit, sizeof limit, "%g", seconds);
    return "hangs when it is opened: no answer after " + std::string(limit) + " s";
  }
  return end_of(status);
}

}  // namespace cleave::plugins
