//! Kinds of errors when a service is opened: iceoryx2 has a separate error type for each messaging pattern.

use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{
    RequestResponseOpenError, RequestResponseOpenOrCreateError,
};

use crate::error::{BusError, of_iceoryx};
use crate::paths::InstancePaths;

/// Kind of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// The service was made by a process built from other sources: other types, quality, or version of iceoryx2.
    Mismatch,
    /// The description of the service is unreadable: incomplete, or written by another version of iceoryx2.
    Corrupted,
    /// The service belongs to another user.
    Permission,
    /// Any other error: the service is incomplete, or the operating system refused.
    System,
}

/// Error of opening a service.
pub(crate) trait OpenError: std::fmt::Debug {
    /// Kind of this error.
    fn trouble(&self) -> Trouble;

    /// Error of opening the service `name` of the instance at `paths`.
    fn explain(&self, paths: &InstancePaths, name: &str) -> BusError
    where
        Self: Sized,
    {
        match self.trouble() {
            Trouble::Mismatch | Trouble::Corrupted => BusError::Version { topic: name.to_owned() },
            Trouble::Permission => BusError::Permission { path: paths.root.clone() },
            Trouble::System => {
                of_iceoryx(format!("opening `{name}` of instance `{}`", paths.instance), self)
            }
        }
    }
}

impl OpenError for PublishSubscribeOpenOrCreateError {
    fn trouble(&self) -> Trouble {
        use PublishSubscribeOpenError as E;
        let Self::PublishSubscribeOpenError(error) = self else { return Trouble::System };
        match error {
            E::IncompatibleTypes
            | E::IncompatibleMessagingPattern
            | E::IncompatibleAttributes
            | E::IncompatibleOverflowBehavior
            | E::DoesNotSupportRequestedMinBufferSize
            | E::DoesNotSupportRequestedMinHistorySize
            | E::DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | E::DoesNotSupportRequestedAmountOfPublishers
            | E::DoesNotSupportRequestedAmountOfSubscribers
            | E::DoesNotSupportRequestedAmountOfNodes
            | E::VersionMismatch => Trouble::Mismatch,
            E::ServiceInCorruptedState => Trouble::Corrupted,
            E::InsufficientPermissions => Trouble::Permission,
            _ => Trouble::System,
        }
    }
}

impl OpenError for RequestResponseOpenOrCreateError {
    fn trouble(&self) -> Trouble {
        use RequestResponseOpenError as E;
        let Self::RequestResponseOpenError(error) = self else { return Trouble::System };
        match error {
            E::IncompatibleRequestOrResponseType
            | E::IncompatibleMessagingPattern
            | E::IncompatibleAttributes
            | E::IncompatibleOverflowBehaviorForRequests
            | E::IncompatibleOverflowBehaviorForResponses
            | E::IncompatibleBehaviorForFireAndForgetRequests
            | E::DoesNotSupportRequestedAmountOfClientRequestLoans
            | E::DoesNotSupportRequestedAmountOfActiveRequestsPerClient
            | E::DoesNotSupportRequestedResponseBufferSize
            | E::DoesNotSupportRequestedAmountOfServers
            | E::DoesNotSupportRequestedAmountOfClients
            | E::DoesNotSupportRequestedAmountOfNodes
            | E::DoesNotSupportRequestedAmountOfBorrowedResponsesPerPendingResponse
            | E::VersionMismatch => Trouble::Mismatch,
            E::ServiceInCorruptedState => Trouble::Corrupted,
            E::InsufficientPermissions => Trouble::Permission,
            _ => Trouble::System,
        }
    }
}
