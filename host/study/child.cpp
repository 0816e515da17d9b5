#include "study/child.hpp"

#include "common/error.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

namespace cleave::study {
namespace {

constexpr int cannot_execute = 127;

}  // namespace

Child::Child(const std::vector<std::string>& command, const std::filesystem::path& log)
    : start_(std::chrono::steady_clock::now()) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const int output = ::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (output < 0) throw InputError("cannot write " + log.string() + ": " + std::generic_category().message(errno));
  const pid_t parent = ::getpid();
  pid_ = ::fork();
  if (pid_ == 0) {
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(cannot_execute);
    const int nothing = ::open("/dev/null", O_RDONLY);
    ::dup2(nothing, STDIN_FILENO);
    ::dup2(output, STDOUT_FILENO);
    ::dup2(output, STDERR_FILENO);
    ::execvp(arguments[0], arguments.data());
    ::_exit(cannot_execute);
  }
  const int reason = errno;
  ::close(output);
  if (pid_ < 0) throw InputError("cannot start another process: " + std::generic_category().message(reason));
  ::setpgid(pid_, pid_);  // whichever of the two is first
}

Child::Child(Child&& other) noexcept : pid_(std::exchange(other.pid_, -1)), status_(other.status_), start_(other.start_) {}

Child::~Child() { kill(); }

double Child::seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

std::optional<int> Child::ended() {
  if (status_ || pid_ < 0) return status_;
  int status = 0;
  if (::waitpid(pid_, &status, WNOHANG) == pid_) status_ = status;
  return status_;
}

void Child::kill() {
  if (pid_ < 0 || status_) return;
  ::kill(-pid_, SIGKILL);
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  status_ = status;
}

std::optional<int> try_program(const std::vector<std::string>& command, const std::filesystem::path& log) {
  Child child(command, log);
  while (!child.ended()) ::usleep(2000);
  const int status = *child.ended();
  if (WIFEXITED(status) && WEXITSTATUS(status) == cannot_execute) return std::nullopt;
  return status;
}

}  // namespace cleave::study
